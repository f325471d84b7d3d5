"""The public Python API, behind ``import dragon_ros``, which imports each module on first use."""
