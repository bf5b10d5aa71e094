"""The spine: commands, configuration and artifacts. Knows the order of the stages, nothing of physics."""

__version__ = "0.1.0"
