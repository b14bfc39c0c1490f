"""The live robot: a session that users steer while it flies or crawls, and the web page that shows it."""
