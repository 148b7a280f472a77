"""Sensing: `camera` (models) -> `images` (pairs) -> `disparity` -> `cloud` (points over the floor).

`precision` holds what matching errs by.
"""
