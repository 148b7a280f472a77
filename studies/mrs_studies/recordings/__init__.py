"""Converters: foreign recordings as bags of our topics."""
