"""Programs as text for LLVM."""
