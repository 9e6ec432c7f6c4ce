"""Translation of programs to LLVM text."""
