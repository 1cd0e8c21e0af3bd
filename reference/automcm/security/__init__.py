"""Signed messages: certificates, the envelope, its signer and its verifier (docs/secured.md).

Pure functions and values: the time and the keys are arguments.
Secured links and the service import it; it imports only the codecs and messages.
"""
