"""The report's figures: small multiples of Vega-Lite charts, each over rows that one query answered."""
