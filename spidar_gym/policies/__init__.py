"""What can act: protocol, presets, learned artifacts, and how a name leads to one."""
