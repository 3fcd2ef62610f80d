// Numbers for people: as many digits as the error allows; the full value stays in the CSV and in data-value.
import type { Measured } from "./contract";

const kMinus = "\u2212";

function plain(value: number, decimals: number): string {
  return value.toFixed(Math.min(Math.max(decimals, 0), 12)).replace("-", kMinus);
}

/** Four significant digits; powers of ten only where plain digits would be long. */
export function number(value: number | null): string {
  if (value === null || !Number.isFinite(value)) return "\u2013";
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(value)));
  if (magnitude >= 7 || magnitude < -4) {
    const [digits, power] = value.toExponential(2).split("e");
    const lead = digits.replace(/\.?0+$/, "").replace("-", kMinus);
    const factor = lead === "1" ? "" : lead === `${kMinus}1` ? kMinus : `${lead}×`;
    return `${factor}10${superscript(Number(power))}`;
  }
  const text = plain(value, 3 - magnitude);
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

function superscript(power: number): string {
  return [...String(power)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
}

/** "0.2804 ± 0.0011": two digits of the error rule the value's digits. */
export function measured({ value, error }: Measured): string {
  if (value === null || error === null || !(error > 0) || !Number.isFinite(value)) return number(value);
  const decimals = 1 - Math.floor(Math.log10(error));
  if (decimals > 8 || Math.abs(value) >= 1e9) return `${number(value)} ± ${number(error)}`;
  return `${plain(value, decimals)} ± ${plain(error, decimals)}`;
}

/** "DN/e-" reads better as "DN/e⁻"; pure numbers have no unit. */
export function unit(text: string): string {
  return text === "1" ? "" : text.replace("e-", "e⁻").replace("^2", "²");
}

export function withUnit(name: string, unitText: string): string {
  const shown = unit(unitText);
  return shown ? `${name} [${shown}]` : name;
}
