"""OpenGL, once: context, shader programs, the frame's uniform block, render targets, timers."""
