"""Write the report: the last part of a Markdown file, one PNG per chart, and an HTML page with all charts."""

import json
from dataclasses import asdict
from html import escape
from importlib.resources import files
from pathlib import Path

from fecocodec.atomic import make_folder, write_file
from fecocodec.evaluation.evaluation import weights_label
from fecocodec.evaluation.machine import describe_machine
from fecocodec.evaluation.report.complexity_section import complexity_section
from fecocodec.evaluation.report.rate_section import rate_sections
from fecocodec.evaluation.report.scaling_section import scaling_section
from fecocodec.evaluation.report.section import Chart, ReportPlan, Section, write_png
from fecocodec.evaluation.report.speed_section import speed_section
from fecocodec.evaluation.report.stress_section import stress_section
from fecocodec.evaluation.report.studies import OnStudy, Studies, measure_studies

TEMPLATE = "page.html"


def html_page(title: str, subtitle: str, charts: tuple[Chart, ...]) -> str:
    """Return the HTML text. The charts are embedded as JSON."""
    template = files(__package__).joinpath(TEMPLATE).read_text()
    data = json.dumps([asdict(chart) for chart in charts]).replace("<", "\\u003c")  # no `</script>` inside the script
    parts = {"@TITLE@": escape(title), "@SUBTITLE@": escape(subtitle), "@CHARTS@": data}
    for mark, text in parts.items():
        template = template.replace(mark, text)
    return template


TITLE = "# Quality and speed\n\n"  # of a page that is not there yet
MARK = "<!-- `make report` writes everything below. -->\n"
HEAD = """\
## Measurements of `make report`

{machine}. Weights `{model}` ({label}). The charts are also on an [interactive page](report/charts.html) with tooltips.
"""


def make_report(plan: ReportPlan, on_study: OnStudy) -> tuple[str, ...]:
    """Run the missing measurements and write the report. Returns one sentence per failed measurement.

    on_study: called with the name of each study before it starts. Raises FecoError if nothing can be measured, or if a
    file cannot be written.
    """
    studies = measure_studies(plan, on_study)
    on_study("writing")
    _write(plan, _sections(plan, studies))
    measurements = (*studies.rate, *studies.speed, *studies.photographs, *studies.more_views)
    return tuple(dict.fromkeys(f"{m.entry}, {m.system}, {m.setting}: {m.error}" for m in measurements if m.error))


def _sections(plan: ReportPlan, studies: Studies) -> tuple[Section, ...]:
    return (
        *rate_sections(studies.rate, studies.more_views),
        speed_section(studies.rate, studies.speed, studies.steps, plan.room_side),
        scaling_section(studies.loads, plan.room_side),
        complexity_section(studies.photographs, studies.complexity, studies.needs),
        stress_section(studies.verdicts),
    )


def _write(plan: ReportPlan, sections: tuple[Section, ...]) -> None:
    folder = plan.output / "report"
    make_folder(folder)
    machine = ", ".join(f"{name} {value}" for name, value in describe_machine().items())
    charts = tuple(chart for section in sections for chart in section.charts)
    for chart in charts:
        write_png(chart, folder / f"{chart.name}.png")
    head = HEAD.format(
        machine=machine[0].upper() + machine[1:], model=plan.model.name, label=weights_label(plan.model, plan.size)
    )
    body = "\n\n".join(f"### {section.title}\n\n{section.text.strip()}" for section in sections)
    page = html_page("FeCoSplat: rate, quality, speed", f"{machine}.", charts)
    report = plan.output / "report.md"
    for path, text in ((report, f"{_kept(report)}{MARK}\n{head}\n{body}"), (folder / "charts.html", page)):
        write_file(path, text.rstrip("\n") + "\n", overwrite=True)


def _kept(report: Path) -> str:
    """Return what stands above the mark of a report, which other commands and people write."""
    return report.read_text().partition(MARK)[0] if report.exists() else TITLE
