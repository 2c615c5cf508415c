"""The contents of the windows, drawn with ImGui. What they show and do lives in `app.session`."""
