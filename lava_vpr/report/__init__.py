"""The pages of ``eval --report`` and ``query --report``: one self-contained HTML file each, made from plain arrays.

`html.page` writes the evaluation report from `ReportData`. This room draws figures and computes none: they come from
`matching.evaluation`, so that the report and the JSON agree.
"""
