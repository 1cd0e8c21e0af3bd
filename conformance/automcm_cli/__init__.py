"""The command automcm."""
