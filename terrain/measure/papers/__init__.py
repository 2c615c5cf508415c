"""The papers' own tables and figures on this machine: a module for each algorithm, found by its name."""
