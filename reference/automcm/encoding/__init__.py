"""Messages as bytes: JSON and ASN.1 UPER, and their sizes.

For the service, the links and the evaluation.
Imports only the definitions of the messages.
"""
