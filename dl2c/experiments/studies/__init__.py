"""Six examples studied: what is proved of each, what is learned in it, and what its guards cost and buy."""
