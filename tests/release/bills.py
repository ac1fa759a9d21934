"""Checks the bills of materials and licences of a release.

    bills.py FOLDER
"""

import json
import pathlib
import re
import sys

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

# Product: lock file, crates that it contains, crates that only its build runs, crates of neither.
PRODUCTS = {
    "trinocular": ("Cargo.lock", ["nalgebra", "serialport", "foxglove", "v4l", "uplot", "rust-std"],
                   ["bindgen", "clap_derive"], ["proptest", "windows-sys", "pyo3"]),
    "trinocular-python": ("host/python/Cargo.lock", ["pyo3", "numpy", "uplot"], ["pyo3-macros"],
                          ["foxglove", "v4l"]),
    "station-b": ("firmware/Cargo.lock", ["embassy-stm32", "trinocular-core"], ["syn"],
                  ["defmt", "nalgebra-macros", "uplot", "clap"]),
}


def check(path, lock, contained, build_only, absent):
    """Checks one bill."""
    text = path.read_text(encoding="utf-8")
    wrong = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    assert wrong is None, f"{path.name}: {wrong}"
    bill = json.loads(text)
    components = bill["components"]
    scopes = {each["name"]: each["scope"] for each in components}
    assert all(scopes.get(name) == "required" for name in contained), (path.name, contained)
    assert all(scopes.get(name) == "excluded" for name in build_only), (path.name, build_only)
    assert not scopes.keys() & set(absent), (path.name, scopes.keys() & set(absent))

    # Every crate of others has the checksum that cargo checks before it builds.
    locked = {
        (name, version): checksum for name, version, checksum in re.findall(
            r'name = "(.*)"\nversion = "(.*)"\nsource = ".*"\nchecksum = "(.*)"',
            pathlib.Path(lock).read_text(encoding="utf-8"))}
    crates = [each for each in components if each.get("purl", "").startswith("pkg:cargo/")]
    for crate in crates:
        expected = locked[crate["name"], crate["version"]]
        assert crate["hashes"] == [{"alg": "SHA-256", "content": expected}], crate
    assert len(crates) > 50, len(crates)

    # The product needs every component, directly or through others.
    needs = {each["ref"]: each["dependsOn"] for each in bill["dependencies"]}
    reached, waiting = set(), [bill["metadata"]["component"]["bom-ref"]]
    while waiting:
        ref = waiting.pop()
        if ref not in reached:
            reached.add(ref)
            waiting += needs.get(ref, [])
    refs = {each["bom-ref"] for each in components}
    assert reached - refs == {bill["metadata"]["component"]["bom-ref"]}, reached - refs
    assert refs <= reached, refs - reached

    # Licences of everything that is linked.
    licences = path.with_name(path.name.replace(".cdx.json", "-licences.txt"))
    named = licences.read_text(encoding="utf-8")
    for crate in crates:
        assert (crate["scope"] == "required") == (f"\n{crate['bom-ref']}: " in named), crate
    print(f"{path.name}: {len(components)} components, valid CycloneDX 1.6")


def main(folder):
    """Checks all bills, of which there is one for each product."""
    bills = sorted(pathlib.Path(folder).glob("*.cdx.json"))
    assert len(bills) == len(PRODUCTS), bills
    for path in bills:
        check(path, *PRODUCTS[re.match(r"(.*)-[0-9]", path.name).group(1)])


main(*sys.argv[1:])
