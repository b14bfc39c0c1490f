"""Locomotion with both gaits in one controller: crawl, take off, fly, land."""
