"""What the windows show, and everything a key or a widget can do to it. Knows no window and no ImGui."""
