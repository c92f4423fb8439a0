"""What the readers make of damaged files: how often they fail in each format, beside the goal 0.

    python benchmarks/mutated_files.py [--mutants 2000] [--seed 1] [--only csv …]

Bytes are flipped, cut out, inserted, repeated and zeroed, and files cut off, at random places. Each
mutant is opened, parsed and guessed. "refused" are those said to be damaged; "same" give what was
written; "other" give values that no reader can tell from the written ones, such as a digit flipped
in text. The faults are named below with the number that makes them again.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from recordings.mutants import FORMATS, run

FAULTS = ("traceback", "hang", "crash", "silent")
KINDS = ("refused", "same", "other", *FAULTS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mutants", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=list(FORMATS), default=list(FORMATS))
    options = parser.parse_args()
    told = run(options.seed, options.mutants, only=tuple(options.only))
    print(f"{'':<20}{'mutants':>9}" + "".join(f"{kind:>11}" for kind in KINDS))
    for form in (*options.only, "all"):
        count = Counter(t.kind for t in told if form in (t.form, "all"))
        figures = "".join(f"{count[kind]:>11}" for kind in KINDS)
        print(f"{form:<20}{count.total():>9}{figures}")
    print(f"{'goal':<20}{'':>42}" + f"{0:>11}" * len(FAULTS))
    for t in filter(lambda t: t.is_fault, told):
        last = t.text.strip().rpartition("\n")[2][:150]
        print(f"{t.kind}: {t.form}, number {t.number} ({t.operation}), seed {options.seed}: {last}")


if __name__ == "__main__":
    main()
