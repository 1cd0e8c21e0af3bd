"""Messages as bytes: JSON and ASN.1 UPER, and how large they are.

For the service, the links and the evaluation.
Imports the grammar of the messages alone.
"""
