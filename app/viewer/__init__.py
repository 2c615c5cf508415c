"""The window itself: its loop, its input, and the frame around the picture: menu, docks, status line, help, overlay."""
