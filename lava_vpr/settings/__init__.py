"""What settings share: ranges of values; settings of the network that is there to compare with."""
