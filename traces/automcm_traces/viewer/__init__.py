"""Shows a run as one HTML page. Its JavaScript is beside the modules.

Used by ``trace html``.
The commands, the reports and maintenance import it.
"""
