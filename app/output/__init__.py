"""Pictures, frames, films and positions on disk."""
