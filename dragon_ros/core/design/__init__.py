"""Questions about what to build, each answered with bounds: pitch, room and speed."""
