"""From what was typed, chosen or dropped to what can be shown: terrains, settings, layers, files."""
