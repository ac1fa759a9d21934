"""The crates that a package of this repository is built from, as cargo resolves them."""

import dataclasses
import json
import pathlib
import re
import subprocess


@dataclasses.dataclass
class Crate:
    """One crate: cargo's metadata, and its place in the build."""

    about: dict  # an item of `packages` of `cargo metadata`
    linked: bool  # part of the product; otherwise it runs during the build only
    sha256: str | None  # of the registry's archive; None for crates of this repository
    needs: list  # keys of the crates that it depends on

    @property
    def key(self):
        """Returns name and version, which are unique within a build."""
        return f"{self.about['name']}@{self.about['version']}"

    @property
    def folder(self):
        """Returns the folder of its sources."""
        return pathlib.Path(self.about["manifest_path"]).parent

    @property
    def licence(self):
        """Returns its licences as an SPDX expression; a slash is the old way to write OR."""
        return " ".join(self.about["license"].replace("/", " OR ").split())


def cargo(*arguments):
    """Returns what cargo prints."""
    return subprocess.run(["cargo", *arguments], check=True, stdout=subprocess.PIPE,
                          text=True).stdout


def tree(selection, edges):
    """Returns what each crate needs, by key, as `cargo tree` follows these kinds of edges."""
    lines = cargo("tree", *selection, "--locked", "--edges", edges, "--prefix", "depth",
                  "--format", " {p}").splitlines()
    needs, path = {}, []
    for line in lines:
        depth, name, version = re.match(r"(\d+) (\S+) v(\S+)", line).groups()
        key = f"{name}@{version}"
        del path[int(depth):]
        # The dependencies of a crate are listed where it first appears.
        needs.setdefault(key, set())
        if path:
            needs[path[-1]].add(key)
        path.append(key)
    return needs


def checksums(lock):
    """Returns the SHA-256 of each crate of a lock file by key."""
    found = {}
    for item in lock.read_text(encoding="utf-8").split("[[package]]")[1:]:
        fields = dict(re.findall(r'^(name|version|checksum) = "(.*)"$', item, re.MULTILINE))
        if "checksum" in fields:
            found[f"{fields['name']}@{fields['version']}"] = fields["checksum"]
    return found


def crates(manifest, package, platform, options):
    """Returns the crates of a package on a platform by key, sorted."""
    workspace = ["--manifest-path", manifest]
    chosen = [*workspace, "--package", package, "--target", platform, *options]
    built = tree(chosen, "normal,build")
    linked = tree(chosen, "normal,no-proc-macro")
    # With all features: those of one package cannot be chosen here.
    metadata = json.loads(cargo("metadata", *workspace, "--format-version", "1", "--locked",
                                "--all-features", "--filter-platform", platform))
    sums = checksums(pathlib.Path(metadata["workspace_root"]) / "Cargo.lock")
    found = {}
    for about in metadata["packages"]:
        key = f"{about['name']}@{about['version']}"
        if key in built:
            found[key] = Crate(about, key in linked, sums.get(key), sorted(built[key]))
    assert found.keys() == built.keys(), found.keys() ^ built.keys()
    return dict(sorted(found.items()))
