"""Scores against ground truth: positions, tracks, stragglers."""
