"""Sums up the reports of the steps of `./run test`. The last line of its output is for machines.

Usage: summary.py FOLDER STEP... A STEP is NAME=passed, NAME=failed, or the name of a report in the folder (STEP.xml;
for ctest also a .json of each executable). A step without its report has failed.
"""

import json
import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def junit_cases(path):
    """Yields (name, passed) for each case that was not skipped."""
    for case in ElementTree.parse(path).iter("testcase"):
        if case.find("skipped") is None:
            failed = case.find("failure") is not None or case.find("error") is not None
            yield case.get("name"), not failed


def gtest_cases(path):
    for suite in json.loads(path.read_text(encoding="utf-8"))["testsuites"]:
        for case in suite["testsuite"]:
            if case["status"] == "RUN" and case.get("result") != "SKIPPED":
                yield f"{suite['name']}.{case['name']}", "failures" not in case


def ctest_cases(path):
    """Yields the cases of each executable, and one failure more for an executable that crashed, or that failed
    although all its cases passed."""
    for name, passed in junit_cases(path):
        report = path.with_name(f"{name}.json")
        cases = list(gtest_cases(report)) if report.exists() else [(name, passed)]
        if not passed and all(ok for _, ok in cases):
            cases.append((name, False))
        for case, ok in cases:
            yield f"{name}: {case}", ok


def step_cases(folder, step):
    name, has_result, result = step.partition("=")
    if has_result:
        return [(name, result == "passed")]
    report = folder / f"{name}.xml"
    if not report.exists():
        return [(f"{name}: no report", False)]
    cases = ctest_cases(report) if report.stem == "ctest" else junit_cases(report)
    return [(f"{name}: {case}", ok) for case, ok in cases]


def main(folder, *steps):
    cases = [case for step in steps for case in step_cases(pathlib.Path(folder), step)]
    failed = [name for name, passed in cases if not passed]
    if failed:
        print("\nFailed:", *failed, sep="\n  ")
    print(f"\n{len(cases) - len(failed)} passed, {len(failed)} failed")
    return 1 if failed or not cases else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
