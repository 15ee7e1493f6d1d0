"""The command line: one module per command, with its configuration, run and report."""
