"""The command `sensorbook`: thin over the library, which it imports only where it is needed."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any

from sensorbook import InputError, __version__, arguments_as
from sensorbook.arguments_as import above_zero, count


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code: 0 done, 1 something failed, 2 usage, 3 gate, 130
    stopped."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a file's name may hold anything
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as end:  # argparse has said why
        return int(end.code or 0)
    try:
        return arguments.run(arguments)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output has enough: nothing is left to be told
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except InputError as error:
        if arguments.debug:
            traceback.print_exc()
        else:
            print(error, file=sys.stderr)
        return 1
    except Exception as error:
        if arguments.debug:
            traceback.print_exc()
        else:
            line = " ".join(f"{type(error).__name__}: {error}".split())
            print(f"{line} (a fault; --debug shows where)", file=sys.stderr)
        return 1


def _report(arguments: argparse.Namespace) -> int:
    from sensorbook.reporting.chapters import CHAPTERS

    known = [chapter.slug for chapter in CHAPTERS if chapter.needs_device]
    if unknown := [slug for slug in arguments.only or () if slug not in known]:
        print(
            f"sensorbook report: --only: no chapter {', '.join(map(repr, unknown))};"
            f" choose from {', '.join(known)}",
            file=sys.stderr,
        )
        return 2
    from sensorbook.reporting.run import report

    return report(
        arguments.paths,
        arguments.out,
        jobs=arguments.jobs,
        only=arguments.only or (),
        debug=arguments.debug,
        gated=arguments.gate,
        junit_file=arguments.junit,
        force=arguments.force,
        engine=arguments.engine,
        cluster=arguments.cluster,
    )


def _book(arguments: argparse.Namespace) -> int:
    from sensorbook.reporting.book import book

    return book(
        arguments.paths,
        arguments.out,
        jobs=arguments.jobs,
        debug=arguments.debug,
        force=arguments.force,
    )


def _check(arguments: argparse.Namespace) -> int:
    from sensorbook.guessing import told
    from sensorbook.recordings import check_device

    failed = False
    for path in arguments.paths:
        device, problems, findings = check_device(path)
        for line in told(device.guessed) if device and device.guessed else ():
            print(line)
        prefix = f"{path}: " if len(arguments.paths) > 1 else ""
        for problem in problems:
            print(f"{prefix}{problem}", file=sys.stderr)
        findings = [*findings, *(device.advice() if device else ())]
        for finding in findings:
            print(f"{prefix}warning: {finding}")
        if not problems:
            warnings = f"{len(findings)} warning{'' if len(findings) == 1 else 's'}"
            print(f"{path}: {warnings if findings else 'nothing to mend'}")
        failed = failed or bool(problems)
    return int(failed)


def _new(arguments: argparse.Namespace) -> int:
    from pathlib import Path

    from sensorbook.guessing import new_device, told

    guessed = new_device(Path(arguments.folder), [Path(file) for file in arguments.files])
    for line in told(guessed):
        print(line)
    print(
        f"{arguments.folder}/device.toml: written; read it, then: sensorbook report {arguments.folder}"
    )
    return 0


def _simulate(arguments: argparse.Namespace) -> int:
    from sensorbook.simulate import PRESETS, simulate

    if arguments.preset not in PRESETS:
        print(
            f"sensorbook simulate: --preset: no preset {arguments.preset!r};"
            f" choose from {', '.join(PRESETS)}",
            file=sys.stderr,
        )
        return 2
    simulate(arguments.folder, preset=arguments.preset, seed=arguments.seed)
    print(f"{arguments.folder}: written; next: sensorbook report {arguments.folder}")
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from sensorbook.export import FORMATS, export, listed, write

    def usage(message: str) -> int:
        print(f"sensorbook export: {message}", file=sys.stderr)
        return 2

    if arguments.list:
        for line in listed(arguments.results):
            print(line)
        return 0
    if arguments.results is None or arguments.format is None:
        return usage("name a RESULTS.json and a --format; --list shows the formats")
    if arguments.format not in FORMATS:
        return usage(f"--format: no format {arguments.format!r}; choose from {', '.join(FORMATS)}")
    if FORMATS[arguments.format].binary and arguments.output is None:
        return usage(f"--format {arguments.format} is binary: name the file to write with -o FILE")
    content = export(arguments.results, arguments.format)
    if arguments.output is None:
        print(content, end="", flush=True)
    else:
        write(arguments.output, content, arguments.results)
        print(f"{arguments.output}: written")
    return 0


def _apply(arguments: argparse.Namespace) -> int:
    from sensorbook.apply_file import apply_file

    if arguments.columns and not arguments.sensor:
        print("sensorbook apply: --columns goes with --sensor", file=sys.stderr)
        return 2
    applied = apply_file(
        arguments.results, arguments.file, arguments.output, arguments.sensor, arguments.columns
    )
    for warning in applied.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    for line in applied.done:
        print(line)
    name = "".join(c if c.isprintable() else " " for c in arguments.output)
    print(f"{name}: written")
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from sensorbook.compare import compare, table
    from sensorbook.export.source import read_results

    if len(arguments.results) < 2:
        print("sensorbook compare: name two results.json or more", file=sys.stderr)
        return 2
    results, problems = [], []
    for path in arguments.results:
        try:
            results.append(read_results(path))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(*problems)
    for comparison in compare(results):
        for line in table(comparison):
            print(line)
    return 0


def _plan(arguments: argparse.Namespace) -> int:
    from sensorbook.plan import Usage, overview, plan

    asked = {k: getattr(arguments, k) for k in ("results", "grade", "rate")}
    more = ("sensor", "quantity", "within", "levelling", "span", "reference")
    more = {k: v for k in more if (v := getattr(arguments, k)) is not None}
    try:
        if arguments.kind is not None:
            lines = plan(arguments.kind, **asked, **more).lines()
        elif more:
            raise Usage(f"--{next(iter(more))} goes with a KIND, such as: sensorbook plan static")
        else:
            lines = overview(**asked)
        for line in lines:
            print(line)
    except Usage as problem:
        print(f"sensorbook plan: {problem}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--debug", action="store_true", help="show tracebacks")
    parser = argparse.ArgumentParser(
        prog="sensorbook",
        description="Calibration results and reports from raw recordings of sensors.",
        epilog="example:\n  sensorbook simulate data/demo\n  sensorbook report data/demo",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"sensorbook {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, run: Any, does: str, example: str) -> argparse.ArgumentParser:
        made = commands.add_parser(
            name,
            parents=[common],
            help=does,
            description=does[0].upper() + does[1:] + ".",
            epilog=f"example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        made.set_defaults(run=run)
        return made

    report = command(
        "report",
        _report,
        "render every report of device folders",
        "sensorbook report data/imu-7 data/imu-8 --out reports",
    )
    report.add_argument(
        "paths", nargs="+", metavar="PATH", help="folder with a device.toml, or a recording"
    )
    report.add_argument(
        "--out", type=arguments_as.folder, default="reports", metavar="DIR", help="default: reports"
    )
    report.add_argument(
        "--jobs", type=count, metavar="N", help="chapters side by side; default: one a core"
    )
    report.add_argument("--only", nargs="+", metavar="CHAPTER", help="these chapters alone")
    report.add_argument("--force", action="store_true", help="render what is up to date, too")
    report.add_argument(
        "--engine",
        choices=("warm", "kernel"),
        default="warm",
        help="warm: forks of one process; kernel: a Jupyter kernel a chapter, the reference, which"
        " takes seconds more; default: warm",
    )
    report.add_argument(
        "--cluster",
        type=arguments_as.address,
        metavar="ADDRESS",
        help="render on the workers of a Dask cluster, such as tcp://10.0.0.1:8786",
    )
    report.add_argument(
        "--gate",
        action="store_true",
        help="exit 3 when a limit of [spec] is failed or cannot be decided, or none is given",
    )
    report.add_argument(
        "--junit", metavar="FILE", help="write JUnit XML: a test case a chapter and a limit"
    )

    book = command(
        "book",
        _book,
        "render every chapter once, in reading order, each on the first device that feeds it, there on"
        " the gyroscope where it can be",
        "sensorbook book data/ahrs-demo data/positions-demo data/rotation-demo --out reports",
    )
    book.add_argument(
        "paths",
        nargs="*",
        metavar="DEVICE",
        help="folder with a device.toml; chapters that no DEVICE feeds are not rendered but listed with"
        " the reason, and pages of them removed; without a DEVICE those that need none are rendered",
    )
    book.add_argument(
        "--out",
        type=arguments_as.folder,
        default="reports",
        metavar="DIR",
        help="the book is DIR/book; default: reports",
    )
    book.add_argument(
        "--jobs", type=count, metavar="N", help="chapters side by side; default: one a core"
    )
    book.add_argument("--force", action="store_true", help="render what is up to date, too")

    check = command(
        "check",
        _check,
        "check device folders without computing: every problem, and how to mend it",
        "sensorbook check data/imu-7",
    )
    check.add_argument(
        "paths", nargs="+", metavar="PATH", help="folder with a device.toml, or a recording"
    )

    new = command(
        "new",
        _new,
        "write a commented device.toml from recordings, every guess with its reason",
        "sensorbook new data/imu-7 --from log.csv",
    )
    new.add_argument("folder", metavar="DIR", help="device folder to write")
    new.add_argument("--from", dest="files", nargs="+", required=True, metavar="FILE",
                     help="recordings of one device; copied into DIR where they lie elsewhere")  # fmt: skip

    from sensorbook.simulate import PRESETS

    listed = "; ".join(f"{name}: {what}" for name, what in PRESETS.items())
    simulate = command(
        "simulate",
        _simulate,
        "write a simulated device folder, with the truth beside it",
        "sensorbook simulate data/demo --seed 1",
    )
    simulate.add_argument("folder", metavar="DIR", help="folder to write")
    simulate.add_argument(
        "--seed", type=arguments_as.seed, default=1, metavar="N", help="default: 1"
    )
    simulate.add_argument(
        "--preset", default="ahrs", metavar="NAME", help=f"{listed}; default: ahrs"
    )

    from sensorbook.export import FORMATS

    listed = "; ".join(f"{one.name}: {one.what} ({one.suffix})" for one in FORMATS.values())
    export = command(
        "export",
        _export,
        "write a device's results for another system",
        "sensorbook export reports/imu-7/results.json --format kalibr -o imu.yaml\n"
        "  sensorbook export --list",
    )
    export.add_argument(
        "results", nargs="?", metavar="RESULTS.json", help="results.json of a report"
    )
    export.add_argument("--format", metavar="NAME", help=listed)
    export.add_argument(
        "--list",
        action="store_true",
        help="a table of the formats; with RESULTS.json, whether it suffices for each",
    )
    export.add_argument(
        "-o", "--output", metavar="FILE", help="file to write; default: standard output"
    )

    apply = command(
        "apply",
        _apply,
        "correct a raw recording with the calibration found, in its own table and unit",
        "sensorbook apply reports/imu-7/results.json log.csv -o corrected.csv",
    )
    apply.add_argument("results", metavar="RESULTS.json", help="results.json of the device")
    apply.add_argument("file", metavar="FILE", help="raw recording, as those of the device")
    apply.add_argument("-o", "--output", required=True, metavar="FILE", help="file to write")
    apply.add_argument(
        "--sensor", choices=("accelerometer", "gyroscope", "magnetometer"), help="this sensor alone"
    )
    apply.add_argument(
        "--columns", type=arguments_as.columns, metavar="x=…,y=…,z=…",
        help="its columns, where not those of the device's recordings; temperature=…, time=… too",
    )  # fmt: skip

    compare = command(
        "compare",
        _compare,
        "compare results of one device over time, or of several devices, in standard errors",
        "sensorbook compare 2024/imu-7/results.json 2025/imu-7/results.json",
    )
    compare.add_argument(
        "results", nargs="+", metavar="RESULTS.json", help="two or more; of one device the earliest, "
        "else the first, is the reference"
    )  # fmt: skip

    plan = command(
        "plan",
        _plan,
        "tell how to record each kind for a wanted accuracy, and what that will give",
        "sensorbook plan"
        "\n  sensorbook plan static --sensor gyroscope --quantity bias_instability --within 10%"
        " --from reports/imu-7/results.json"
        '\n  sensorbook plan positions --sensor accelerometer --within "0.1 mg" --grade industrial'
        "\n  sensorbook plan thermal --span 40",
    )
    plan.add_argument(
        "kind", nargs="?", metavar="KIND", help="static, positions, six_position, rotation, thermal, "
        "trajectory or images; default: all in short"
    )  # fmt: skip
    plan.add_argument("--sensor", metavar="NAME", help="default: the kind's first")
    plan.add_argument(
        "--quantity", metavar="NAME", help="as results.json names it, such as random_walk, bias or "
        "scale_factor_error; default: the kind's first"
    )  # fmt: skip
    plan.add_argument(
        "--within", metavar="X", help="half the 95 %% interval that is wanted: of a noise level 10%% or "
        'a number with its unit, such as "0.1 mg", "200 ppm", "0.5 deg/h"'
    )  # fmt: skip
    plan.add_argument(
        "--from", dest="results", metavar="RESULTS.json", help="noise of a device already measured"
    )
    plan.add_argument(
        "--grade", metavar="NAME", help="typical noise: consumer, industrial or tactical; default: consumer"
    )  # fmt: skip
    plan.add_argument(
        "--rate", type=above_zero, metavar="HZ", help="default: the device's own, else 100"
    )
    plan.add_argument(
        "--levelling", type=above_zero, metavar="DEG", help="six_position: rms; default: 0.2"
    )
    plan.add_argument("--span", type=above_zero, metavar="C", help="thermal, °C; default: 25")
    plan.add_argument(
        "--reference", type=above_zero, metavar="DEG",
        help="trajectory: a reference's standard error about each axis; default: 0.5",
    )  # fmt: skip
    return parser


if __name__ == "__main__":
    sys.exit(main())
