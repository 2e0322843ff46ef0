"""The address of the repository that the first page links to: that of the project, or of the clone
with these pages.
"""

from __future__ import annotations

import html
import re
import subprocess
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import urlsplit

#: whose pages of a file the theme can address; it warns of any other
_KNOWN_HOSTS = ("https://github.com/", "https://gitlab.com/", "https://bitbucket.org/")


def address(project_urls: Iterable[str], root: Path) -> str | None:
    """The URL ``Repository`` of the metadata ("label, address"), else that of the remote ``origin``
    of the clone at root.
    """
    named = dict(url.split(", ", 1) for url in project_urls)
    if "Repository" in named:
        return named["Repository"]
    # where the pages lie in another repository, that one's remote is not ours
    top = _git(root, "rev-parse", "--show-toplevel")
    if not top or Path(top).resolve() != root.resolve():
        return None
    remote = _git(root, "remote", "get-url", "origin")
    return web_address(remote, root) if remote else None


def web_address(remote: str, root: Path) -> str | None:
    """An address that a browser opens, of a remote as git writes it; names, passwords and ports of
    ssh are left out.

    Parameters
    ----------
    remote : an address of https or ssh, ``host:owner/name.git``, or a folder.
    root : the folder that a relative folder starts from.
    """
    scheme, separator, _ = remote.partition("://")
    if separator:
        try:
            parts = urlsplit(remote)
        except ValueError:
            return None
        if scheme == "file":
            return remote
        if (
            scheme not in ("http", "https", "git", "ssh", "git+ssh", "ssh+git")
            or not parts.hostname
        ):
            return None
        web = scheme in ("http", "https")
        host = parts.netloc.rpartition("@")[2] if web else parts.hostname
        return f"{scheme if web else 'https'}://{host}{_page(parts.path)}"
    # a drive has one letter, a host more; a folder has no colon before its first slash
    at_host = re.fullmatch(r"(?:[^/\\:@]+@)?([^/\\:@]{2,}):(.+)", remote)
    if at_host:
        return f"https://{at_host[1]}{_page('/' + at_host[2].lstrip('/'))}"
    return (root / remote).resolve().as_uri()


def theme_options(repository: str | None) -> dict[str, str]:
    """What the theme needs for its links to the source of each page; nothing for a host whose
    addresses it does not know.
    """
    if not repository or not repository.startswith(_KNOWN_HOSTS):
        return {}
    return {"source_repository": repository, "source_branch": "main", "source_directory": "docs/"}


def linked(text: str, repository: str | None) -> str:
    """The text of a page whose words "the repository" are links, except in headings."""
    if not repository:
        return text

    def link(words: re.Match[str]) -> str:
        return f'<a class="reference external" href="{html.escape(repository)}">{words[0]}</a>'

    return re.sub(r"(?<!# )(?<![\[`])\bthe repository\b(?![\]`])", link, text, flags=re.IGNORECASE)


def _page(path: str) -> str:
    return path.rstrip("/").removesuffix(".git")


def _git(folder: Path, *arguments: str) -> str | None:
    """What git says, or None where there is no git, or nothing to say."""
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=20
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
