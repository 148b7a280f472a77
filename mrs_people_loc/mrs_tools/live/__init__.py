"""A running team: what the tools show of it."""
