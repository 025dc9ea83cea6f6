"""Open the page of `newmark-study report`, or the built documentation, and look for faults.

    pip install playwright && playwright install chromium
    python tests/verification/browser.py page.html [--shots FOLDER]
    python tests/verification/browser.py build/site [--shots FOLDER]

Opens every page as a file, at three widths, light and dark: no message on the console, no
request but for what lies beside the page, nothing wider than the window, a text for every
image.  Of a site the search must find what is there, too.  With --shots also writes
screenshots.  Exits with 1 when something is found.  CHROMIUM may name another browser.
"""

import argparse
import os
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

WIDTHS = (400, 800, 1400)
SCHEMES = ("light", "dark")
#: Words of the documentation, and a page that they must lead to.
SOUGHT = {
    "compensated": "what-scaling-cures.html",
    "saturation": "verification.html",
    "SLURM": "studies.html",
    "iteration_cap": "reference/config.html",
}

LOOK = """() => {
  document.querySelectorAll('details').forEach(e => e.open = true);
  const images = [...document.querySelectorAll('main img, article img, body > * svg[role=img]')];
  return {
    wide: Math.max(0, document.documentElement.scrollWidth - window.innerWidth),
    unnamed: images.filter(e => !(e.getAttribute('aria-label') || e.getAttribute('alt'))).length,
    broken: images.filter(e => e.tagName == 'IMG' && !e.naturalWidth).length,
    empty: Number(document.body.innerText.length < 200)};
}"""


def faults(browser, page, beside, width, scheme, shots):
    """What is wrong with one page at one width in one colour scheme."""
    found = []
    tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    tab.on("console", lambda message: found.append(f"console: {message.text}"))
    tab.on("pageerror", lambda error: found.append(f"exception: {error}"))
    tab.on(
        "request",
        lambda request: (
            request.url.startswith((beside.as_uri(), "data:", "blob:"))
            or found.append(f"request: {request.url}")
        ),
    )
    tab.goto(page.as_uri())
    if shots:
        shots.mkdir(parents=True, exist_ok=True)
        name = "-".join(page.relative_to(beside).with_suffix("").parts)
        tab.screenshot(path=shots / f"{name}-{width}-{scheme}.png", full_page=True)
    found += [f"{kind}: {count}" for kind, count in tab.evaluate(LOOK).items() if count]
    tab.close()
    return found


def search_faults(browser, site):
    """Words that the search does not find."""
    for word, target in SOUGHT.items():
        tab = browser.new_page(viewport={"width": 1400, "height": 900})
        tab.goto((site / "index.html").as_uri())
        field = tab.locator("[data-md-component=search-query]")
        field.click()
        field.press_sequentially(word)
        tab.wait_for_selector(".md-search-result__link", state="attached")
        links = tab.eval_on_selector_all(".md-search-result__link", "all => all.map(e => e.href)")
        if not any(target in link for link in links):
            yield f"search for {word}: {len(links)} results, none in {target}"
        tab.close()


def main():
    """Look at all pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("where", type=Path, help="a page, or the folder of a site")
    parser.add_argument("--shots", type=Path)
    given = parser.parse_args()
    where = given.where.resolve(strict=True)
    site = where.is_dir()
    pages = sorted(page for page in where.rglob("*.html") if page.name != "404.html")
    failed = 0
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=os.environ.get("CHROMIUM"))
        for page in pages if site else [where]:
            beside = where if site else where.parent
            for width in WIDTHS:
                for scheme in SCHEMES:
                    for fault in faults(browser, page, beside, width, scheme, given.shots):
                        print(f"{page.relative_to(beside)}, {width} px, {scheme}: {fault}")
                        failed += 1
        for fault in search_faults(browser, where) if site else ():
            print(fault)
            failed += 1
    print(f"{failed} faults")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
