"""``automcm conform``: all its commands."""

from __future__ import annotations

from automcm_cli import certify, conform, conform_explore, conform_live

app = conform.app
app.command(cls=conform.WithCommand, epilog=conform_explore.EPILOG)(conform_explore.explore)
app.command(cls=conform.WithCommand, epilog=conform_live.EPILOG)(conform_live.live)
app.command(epilog=certify.EPILOG)(certify.certify)
