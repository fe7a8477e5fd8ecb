"""What a board is: its limits, its energy constants, and the plan of what stands on its cores."""
