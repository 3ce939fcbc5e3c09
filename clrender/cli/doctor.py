"""`clrender doctor`: diagnoses problems of OpenCL on this machine, with their cures."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.drivers.diagnose import Finding
    from clrender.drivers.probe import DriverReport

__all__ = ["doctor"]


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object instead of text.")
def doctor(as_json: bool) -> None:
    """Check every OpenCL platform in a separate process; print the cause of each problem and how to fix it.

    The exit code is 0 if at least one device is ok, else 3.
    """
    from clrender.drivers.diagnose import diagnose
    from clrender.drivers.probe import examine

    reports = examine(notify=lambda line: click.echo(line, err=True))
    findings = diagnose(reports)
    good = any(info.probe == "ok" for report in reports for info in report.devices)
    if as_json:
        click.echo(json.dumps(_as_json(reports, findings, good), indent=2))
    else:
        _print(reports, findings, good)
    sys.exit(0 if good else 3)


def _as_json(reports: list[DriverReport], findings: list[Finding], good: bool) -> dict[str, Any]:
    drivers = [
        {
            "library": report.driver.library,
            "origin": report.driver.origin,
            "fault": report.fault,
            "platforms": [{"name": n, "version": v, "devices": count} for n, v, count in report.platforms],
            "devices": [{**info.public(), "detail": info.detail} for info in report.devices],
        }
        for report in reports
    ]
    return {"ok": good, "drivers": drivers, "findings": [asdict(finding) for finding in findings]}


def _print(reports: list[DriverReport], findings: list[Finding], good: bool) -> None:
    for report in reports:
        click.echo(f"{report.driver.library or report.driver.origin}  [{report.driver.origin}]")
        for name, version, count in report.platforms:
            click.echo(f"  {name}, {version}: {counted(count, 'device')}")
        for info in report.devices:
            click.echo(f"    {info.index}: {info.name} ({info.type}, driver {info.driver}): {info.probe}")
        if report.fault:
            click.echo(f"  cannot be used: {report.fault}")
    for finding in findings:
        click.echo(f"\n{'note' if finding.harmless else 'FAULT'}: {finding.subject}")
        click.echo(f"  cause: {finding.cause}")
        click.echo(f"  cure:  {finding.cure}")
    click.echo("\nat least one device is ok" if good else "\nno device is ok: clrender cannot render on this machine")
