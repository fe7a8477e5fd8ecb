"""Fewer bits and pruned weights, chosen on images."""
