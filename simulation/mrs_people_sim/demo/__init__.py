"""A recorded team, replayed through its real processes."""
