"""C functions of other libraries, called by machine code with the platform's calling convention."""
