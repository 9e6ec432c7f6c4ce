"""The certificate over a set of operators: the worst of them, the share of a population, and regions."""
