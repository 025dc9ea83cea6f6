"""Open every page of the built documentation in headless Chromium and look for faults.

    mkdocs build && python tests/verification/website.py build/site [--shots FOLDER]

Pages are opened as files, without a server.  Checks, at widths of 400 and 1400 px, light and
dark: no message on the console, no request but for files of the site, nothing wider than the
window, a text for every image that is not decoration, no empty page; and that the search finds
what is there.  With --shots also writes screenshots.  Exits with 1 when something is found.
Needs Chromium, see ``page.py``.
"""

import argparse
import base64
import json
import sys
import time
from pathlib import Path

from page import chromium, opened, value_of

WIDTHS = (400, 1400)
SCHEMES = ("light", "dark")
#: Words and a page that they must lead to.
SOUGHT = {
    "compensated": "what-scaling-cures.html",
    "saturation": "terms.html",
    "sbatch": "long-studies.html",
    "iteration_cap": "reference/config.html",
}

LOOK = """({
  width: document.documentElement.scrollWidth, inner: window.innerWidth,
  height: document.documentElement.scrollHeight,
  text: document.querySelector('article').innerText.length,
  scheme: document.body.dataset.mdColorScheme,
  broken: [...document.querySelectorAll('article img')].filter(e => !e.naturalWidth).length,
  unnamed: [...document.querySelectorAll('article img')].filter(
    e => !e.getAttribute('alt')).length,
  wide: [...document.querySelectorAll('article pre > code, article p, article li')].filter(
    e => e.getBoundingClientRect().right > window.innerWidth + 1
      && !e.closest('.md-typeset__scrollwrap, pre, .dataframe')).length})"""

SEARCH = """(() => {
  const field = document.querySelector('[data-md-component=search-query]');
  document.querySelector('#__search').click();
  field.focus();
  field.value = WORD;
  field.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true}));
  field.dispatchEvent(new Event('input', {bubbles: true}));
  return field.value;
})()"""
FOUND = """[...document.querySelectorAll('.md-search-result__link')].map(e => e.href)"""


def reported(browser, site):
    """Messages on the console, and requests for what is no file of the site."""
    browser.call("Runtime.evaluate", expression="0")  # collects late events
    for event in browser.events:
        method, given = event["method"], event.get("params", {})
        if method in ("Log.entryAdded", "Runtime.consoleAPICalled", "Runtime.exceptionThrown"):
            yield f"{method}: {json.dumps(given)[:300]}"
        if method == "Network.requestWillBeSent":
            url = given["request"]["url"]
            if not url.startswith((site.as_uri(), "data:", "blob:", "about:")):
                yield f"request: {url}"


def faults(browser, site, page, width, scheme, shots):
    """What is wrong with one page."""
    opened(browser, page, width, scheme)
    time.sleep(0.2)
    look = value_of(browser, LOOK)
    if look["width"] > look["inner"] or look["inner"] > width or look["wide"]:
        yield f"{look['width']} px wide, {look['wide']} texts beyond the window"
    for kind in ("broken", "unnamed"):
        if look[kind]:
            yield f"{look[kind]} images {kind}"
    if look["text"] < 200:
        yield "nearly empty"
    if look["scheme"] != {"light": "default", "dark": "slate"}[scheme]:
        yield f"is {look['scheme']}"
    if shots:
        clip = {"x": 0, "y": 0, "width": width, "height": min(look["height"], 9000), "scale": 1}
        shot = browser.call(
            "Page.captureScreenshot", clip=clip, captureBeyondViewport=True, format="png"
        )
        name = "-".join(page.relative_to(site).with_suffix("").parts)
        (shots / f"{name}-{width}-{scheme}.png").write_bytes(base64.b64decode(shot["data"]))
    yield from reported(browser, site)


def search_faults(browser, site):
    """Words that the search does not find."""
    for word, target in SOUGHT.items():
        opened(browser, site / "index.html", 1400, "light")
        time.sleep(0.2)
        value_of(browser, SEARCH.replace("WORD", json.dumps(word)))
        for _ in range(100):
            time.sleep(0.1)
            links = value_of(browser, FOUND)
            if links:
                break
        if not any(target in link for link in links):
            yield f"search for {word}: {len(links)} results, none in {target}"
        yield from reported(browser, site)


def main():
    """Look at all pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("site", type=Path)
    parser.add_argument("--shots", type=Path)
    arguments = parser.parse_args()
    site = arguments.site.resolve(strict=True)
    if arguments.shots:
        arguments.shots.mkdir(parents=True, exist_ok=True)
    pages = sorted(page for page in site.rglob("*.html") if page.name != "404.html")
    failed = 0
    with chromium() as browser:
        # The choice of colours that one page has stored is not for the next.
        browser.call("Page.addScriptToEvaluateOnNewDocument", source="localStorage.clear()")
        for page in pages:
            for width in WIDTHS:
                for scheme in SCHEMES:
                    for fault in faults(browser, site, page, width, scheme, arguments.shots):
                        print(f"{page.relative_to(site)}, {width} px, {scheme}: {fault}")
                        failed += 1
        for fault in search_faults(browser, site):
            print(fault)
            failed += 1
    print(f"{len(pages)} pages, {len(WIDTHS)} widths, light and dark: {failed} faults")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
