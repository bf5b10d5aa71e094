"""What crosses between rooms: errors, configuration base, Arrow schemas, MCAP topics, manifests."""
