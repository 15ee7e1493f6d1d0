"""Benchmarks and the verification suite; ``benchmarks/README.md`` says what each is."""
