"""The command line: a module for what is read, run and told of each command."""
