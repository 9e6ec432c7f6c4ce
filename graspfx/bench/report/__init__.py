"""The report of benchmarks: its rows, its page and its figures."""
