"""Bags: reading, writing, and running one through the pipeline in this process."""
