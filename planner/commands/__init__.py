"""What the command does: a function a subcommand, from its call to its exit status."""
