"""Tours without rendering, faster than real time: walked, localized, or guided."""
