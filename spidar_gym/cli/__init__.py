"""The command line `spidar`, with one module per command."""
