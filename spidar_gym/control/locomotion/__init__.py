"""Both ways of moving in one controller: crawl, take off, fly, land."""
