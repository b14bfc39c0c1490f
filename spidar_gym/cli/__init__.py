"""The command `spidar`: a file a command."""
