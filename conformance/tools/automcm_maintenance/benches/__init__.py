"""``automcm bench``: ratios to a baseline of the same run; and a fuzzer of the decoders."""
