"""Are the tests of the attitude math any good? Break each line of it by cosmic-ray, and count what no test notices.

    pip install -e '.[test,mutation]'
    python -m benchmarks.mutation                  # all modules, two at a time; an hour
    python -m benchmarks.mutation --jobs 4 euler   # or some of them

Works on copies; the checkout stays as it is. Prints each survivor as a difference, then a table. docs/mutation.md says
what the survivors are.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome

TOP = Path(__file__).parents[1]
PACKAGE = Path("gcs_bridge", "attitude")
CONFIG, SESSION = "mutation.toml", "mutation.sqlite"
ENVIRONMENT = {
    **os.environ,
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "OPENBLAS_NUM_THREADS": "1",
}


def tested(module: str, parent: Path) -> tuple[int, list[str]]:
    """Test all mutants of a module in a copy; return how many were killed, and the survivors' differences."""
    copy = parent / module
    for part in (Path("gcs_bridge"), Path("tests", "attitude")):
        shutil.copytree(TOP / part, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(TOP / "pyproject.toml", copy)
    config = Path(__file__).with_name(CONFIG).read_text()
    (copy / CONFIG).write_text(config.replace(f'"{PACKAGE}"', f'"{PACKAGE / module}.py"'))

    def run(*command: str, **changes: str) -> None:
        environment = ENVIRONMENT | changes
        subprocess.run(command, cwd=copy, env=environment, check=True, stdout=subprocess.DEVNULL)

    run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/attitude")  # good as it is, and compiled
    for stale in (copy / "gcs_bridge").rglob("__pycache__"):
        shutil.rmtree(stale)  # a mutant of the same size and second would be taken for the module itself
    run("cosmic-ray", "init", CONFIG, SESSION)
    run("cr-filter-operators", SESSION, CONFIG)
    run("cosmic-ray", "exec", CONFIG, SESSION, PYTHONDONTWRITEBYTECODE="1")
    with use_db(copy / SESSION, WorkDB.Mode.open) as session:
        results = [result for _, result in session.completed_work_items]
    count = sum(result.test_outcome is not None for result in results)  # None: left out by the filter
    survivors = [result.diff for result in results if result.test_outcome is TestOutcome.SURVIVED]
    return count - len(survivors), survivors


def main() -> None:
    """Test the modules, and print."""
    modules = sorted(path.stem for path in (TOP / PACKAGE).glob("*.py") if path.stem != "__init__")
    parser = argparse.ArgumentParser(description="Mutation testing of the attitude math.")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=", ".join(modules))
    parser.add_argument("--jobs", type=int, default=2, help="modules at a time  [2]")
    arguments = parser.parse_args()
    chosen = arguments.modules or modules
    if unknown := set(chosen) - set(modules):
        parser.error(f"no such module: {', '.join(sorted(unknown))}; there are {', '.join(modules)}")
    rows: list[tuple[str, ...]] = [("module", "mutants", "killed", "survived")]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.jobs) as pool:
        tests = [pool.submit(tested, module, Path(folder)) for module in chosen]
        for module, test in zip(chosen, tests, strict=True):
            killed, survivors = test.result()
            print("\n\n".join(survivors), flush=True)
            rows.append((module, *map(str, (killed + len(survivors), killed, len(survivors)))))
    rows.append(("together", *(str(sum(int(row[column]) for row in rows[1:])) for column in (1, 2, 3))))
    for row in rows:
        print("{:12}{:>9}{:>9}{:>9}".format(*row))


if __name__ == "__main__":
    main()
