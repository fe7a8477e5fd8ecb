"""What settings share: ranges of values, declared by annotations."""
