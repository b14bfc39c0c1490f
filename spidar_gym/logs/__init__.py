"""Logs of runner, robot and simulation in one neutral form, `Record`; reading and writing MCAP, bags and CSV."""
