// Elements are made with text nodes only: whatever stands in a report's names is shown, never interpreted.

type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false) made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

let lastId = 0;
export function freshId(stem: string): string {
  return `${stem}-${++lastId}`;
}

/** A select box with its label. */
export function choice(label: string, names: string[], pick: (index: number) => void): HTMLElement {
  const id = freshId("choice");
  const select = element("select", { id, change: () => pick(select.selectedIndex) });
  names.forEach((name, index) => select.append(element("option", { value: index }, name)));
  return element("span", { class: "choice" }, element("label", { for: id }, label), select);
}

export function button(text: string, label: string, press: () => void): HTMLButtonElement {
  return element("button", { type: "button", "aria-label": label, title: label, click: press }, text);
}

/** Hands a file to the reader. */
export function save(name: string, content: Blob): void {
  const link = element("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// File names are those that src/malus/report/write_report.cpp gives to figures.
const kGreek: Record<string, string> = { "μ": "mu", "σ": "sigma", "λ": "lambda", "χ": "chi" };

/** A file name from a title; "at -3 dB" keeps its sign, "0-3 dB" has none. */
export function fileStem(title: string): string {
  const words = title.normalize("NFKD").replace(/[μσλχ]/g, (letter) => kGreek[letter]).replace(/(^|[^A-Za-z0-9])-(?=[0-9])/g, "$1_minus");
  return words.replace(/[^A-Za-z0-9.]+/g, "_").replace(/^_+|_+$/g, "").slice(0, 80) || "malus";
}
