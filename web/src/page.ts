// Title, navigation, theme, and one section after the other.
import type { Block, Report, Section } from "./contract";
import { showCharts } from "./charts";
import { button, element } from "./dom";
import { usePalettes } from "./palettes";
import { showFigures, showNotices, showTable, showText } from "./tables";
import { showPictures } from "./viewer/viewer";

function showBlock(block: Block): HTMLElement {
  switch (block.kind) {
    case "text":
      return showText(block);
    case "notices":
      return showNotices(block);
    case "figures":
      return showFigures(block);
    case "table":
      return showTable(block);
    case "charts":
      return showCharts(block);
    case "pictures":
      return showPictures(block);
  }
}

function showSection(section: Section): HTMLElement {
  const made = element("section", { id: section.id, "aria-labelledby": `${section.id}-title` });
  made.append(element("h2", { id: `${section.id}-title` }, section.title));
  if (section.lead) made.append(element("p", { class: "lead" }, section.lead));
  const grid = element("div", { class: "grid" });
  for (const block of section.blocks) grid.append(showBlock(block));
  made.append(grid);
  return made;
}

function themeSwitch(): HTMLElement {
  const root = document.documentElement;
  const dark = () =>
    root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const made = button("◐", "Switch between light and dark", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    dispatchEvent(new Event("malus-theme"));
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => dispatchEvent(new Event("malus-theme")));
  return made;
}

/** Paper is light, whatever the screen is. */
function printLight(): void {
  const root = document.documentElement;
  let theme: string | undefined, onPaper = false;
  addEventListener("beforeprint", () => {
    if (!onPaper) theme = root.dataset.theme;
    onPaper = true;
    root.dataset.theme = "light";
    dispatchEvent(new Event("malus-theme"));
  });
  addEventListener("afterprint", () => {
    onPaper = false;
    if (theme) root.dataset.theme = theme;
    else delete root.dataset.theme;
    dispatchEvent(new Event("malus-theme"));
  });
}

/** Marks the section in view in the navigation. */
function followScroll(links: Map<string, HTMLElement>, sections: HTMLElement[]): void {
  const observer = new IntersectionObserver(
    (entries) => {
      for (const { target, isIntersecting } of entries) {
        const link = links.get(target.id);
        if (isIntersecting) link?.setAttribute("aria-current", "true");
        else link?.removeAttribute("aria-current");
      }
    },
    { rootMargin: "-10% 0px -70% 0px" },
  );
  for (const section of sections) observer.observe(section);
}

export function showReport(report: Report, page: HTMLElement): void {
  document.title = report.title;
  usePalettes(report.palettes);
  printLight();
  const links = new Map<string, HTMLElement>();
  const list = element("ul");
  for (const { id, title } of report.sections) {
    const link = element("a", { href: `#${id}` }, title);
    links.set(id, link);
    list.append(element("li", {}, link));
  }
  const sections = report.sections.map(showSection);
  page.append(
    element("a", { class: "skip", href: "#content" }, "Skip to the content"),
    element(
      "header",
      {},
      element("div", {}, element("h1", {}, report.title), element("p", {}, report.subtitle)),
      themeSwitch(),
    ),
    // One section is no choice, and its title stands right below.
    ...(sections.length > 1 ? [element("nav", { "aria-label": "Sections" }, list)] : []),
    element("main", { id: "content", tabindex: -1 }, ...sections),
    element("footer", {}, `Made by ${report.program}. Everything shown is inside this file; it loads nothing.`),
  );
  followScroll(links, sections);
}
