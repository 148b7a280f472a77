"""Fitting the body model to bags with ground truth."""
