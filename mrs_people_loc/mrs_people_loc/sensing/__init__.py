"""Sensing: `camera` (models) -> `images` (pairs) -> `disparity` -> `cloud` (points, base_link)."""
