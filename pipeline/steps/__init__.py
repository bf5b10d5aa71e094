"""One module per stage: what it needs, what it makes, and the call between. Commands and `run` share them."""
