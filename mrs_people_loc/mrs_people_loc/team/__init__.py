"""The team on one map: `clocks`, `poses` -> `intervals` -> `fusion` (eq. 6) -> `masking`."""
