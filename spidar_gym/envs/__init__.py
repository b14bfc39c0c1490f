"""Gymnasium environments; importing `spidar_gym` registers them."""
