"""Which routine finds a feature, how well and over which range."""
