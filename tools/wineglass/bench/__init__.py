"""Timings side by side in one run: the product's kernels against float64 numpy and scipy, its loops against theirs."""
