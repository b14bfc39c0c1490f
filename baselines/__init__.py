"""Baselines of the leaderboard, a file each; learned ones are artifacts in `learned/`.

Their class attributes are constants that nobody writes to, so RUF012 asks for nothing there. The reason stands here and
not beside each: a row of the leaderboard holds the hash of the file that it was made with.
"""
