"""What the firmware costs on the processor: instructions executed, flash, memory, stack. Counted, not estimated."""
