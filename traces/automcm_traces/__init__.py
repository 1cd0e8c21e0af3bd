"""What happened: recorded behaviour of stations and counterexamples of the specification."""
