"""One module per command: parse, call, show. Stages are imported inside the functions."""
