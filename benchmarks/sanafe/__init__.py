"""The cost model beside SANA-FE."""
