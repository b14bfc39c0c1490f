"""Refuse words that turn things into persons; docs/development/style.md has the rule."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REFUSED = re.compile(r"\b(?:no|some|any|every)body\b|\bwho[e]ver\b|\bone's own\b", re.IGNORECASE)
"""Subjects that are no things. The pattern does not match itself."""
READ = {".py", ".md", ".c", ".h", ".cpp", ".toml", ".yml", ".js", ".html", ".ipynb"}
"""Suffixes of the files that people read."""
FROZEN = ("baselines/", "CHANGELOG.md", "docs/results/")
"""Rows hold the hashes of the first; the others record what was."""


def main() -> None:
    """Print each line with a refused word; exit status 1 if there is one."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found = [
        f"{name}:{number}: {match.group()}"
        for name in listed.split("\0")
        if Path(name).suffix in READ and not name.startswith(FROZEN) and (ROOT / name).is_file()
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        for match in REFUSED.finditer(line)
    ]
    print("\n".join(found))
    sys.exit(f"{len(found)} words that turn things into persons; valid: see docs/development/style.md" if found else 0)


if __name__ == "__main__":
    main()
