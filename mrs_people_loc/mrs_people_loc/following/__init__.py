"""Following people over time: `tracks` (identity, velocity) -> `groups` (members, stragglers)."""
