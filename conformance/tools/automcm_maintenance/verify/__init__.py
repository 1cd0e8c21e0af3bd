"""``automcm verify``: its stages and its screen."""
