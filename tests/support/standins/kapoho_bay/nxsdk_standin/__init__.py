"""What stands behind the names of the stand-in for NxSDK: a board, its cores, channels and embedded programs."""
