"""HTML page with all charts as interactive graphics with tooltips, without external resources."""

import json
from dataclasses import asdict
from html import escape
from importlib.resources import files

from fecocodec.evaluation.report.charts import Chart

TEMPLATE = "page.html"


def html_page(title: str, subtitle: str, charts: tuple[Chart, ...]) -> str:
    """Return the HTML text. The charts are embedded as JSON."""
    template = files(__package__).joinpath(TEMPLATE).read_text()
    data = json.dumps([asdict(chart) for chart in charts]).replace("<", "\\u003c")  # no `</script>` inside the script
    parts = {"@TITLE@": escape(title), "@SUBTITLE@": escape(subtitle), "@CHARTS@": data}
    for mark, text in parts.items():
        template = template.replace(mark, text)
    return template
