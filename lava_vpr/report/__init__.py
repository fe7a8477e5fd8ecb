"""The evaluation report: one HTML file that needs nothing else, from plain arrays.

`html.page` turns `ReportData` into its text. Everything is drawn here and nothing is computed that
`matching.evaluation` has not computed already, so that the report and the JSON never disagree.
"""
