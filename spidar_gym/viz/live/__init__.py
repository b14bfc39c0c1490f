"""The robot live: a session that people steer while it flies or crawls, and the page in a browser that shows it."""
