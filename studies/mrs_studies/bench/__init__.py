"""The benchmark: scenes, references that results are compared with, timings."""
