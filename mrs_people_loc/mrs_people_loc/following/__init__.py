"""Following people over time: tracks of persons, and the groups they walk in."""
