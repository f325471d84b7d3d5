"""What each effect computes for a frame; the modules of effects that are off stay unloaded."""
