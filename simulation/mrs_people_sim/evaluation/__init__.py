"""Bags through the pipeline, scored against their ground truth."""
