"""Lowering of kernels: functions of records and values become functions of numbers and entries of buffers."""
