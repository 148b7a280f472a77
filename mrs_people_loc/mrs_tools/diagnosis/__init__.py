"""What is wrong with a running team, and what to do: what `mrs doctor` prints."""
