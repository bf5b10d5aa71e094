"""Questions after the fact: SQL views over the logs, statistics over seeds, figures and one report."""
