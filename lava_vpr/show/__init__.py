"""What all tables and pages share: one table for every output, number formats, the frame of pages and its drawings."""
