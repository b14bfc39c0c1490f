"""Crawl-v0: crawl to a pose on the floor."""
