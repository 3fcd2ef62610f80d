// The key to the colours: a bar, or the wheel of polarizer angles.
import { element } from "../dom";
import { number, unit } from "../format";
import { color } from "../palettes";
import type { View } from "./views";

function ink(): string {
  return getComputedStyle(document.documentElement).getPropertyValue("--text").trim();
}

/** The colour at each direction is that of the polarizer axis lying in it, counter-clockwise from the right. */
function wheel(context: CanvasRenderingContext2D, size: number): void {
  const middle = size / 2, outer = size / 2 - 20, inner = outer * 0.45;
  for (let degree = 0; degree < 360; ++degree) {
    const from = (-degree * Math.PI) / 180;
    context.fillStyle = `rgb(${color("cyclic", (degree % 180) / 180).join(",")})`;
    context.beginPath();
    context.arc(middle, middle, outer, from + 0.01, from - Math.PI / 180 - 0.01, true);
    context.arc(middle, middle, inner, from - Math.PI / 180, from, false);
    context.fill();
  }
  context.fillStyle = ink();
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (const degree of [0, 45, 90, 135]) {
    const angle = (degree * Math.PI) / 180;
    context.fillText(`${degree}°`, middle + (outer + 11) * Math.cos(angle), middle - (outer + 10) * Math.sin(angle));
  }
}

function bar(context: CanvasRenderingContext2D, view: View, low: number, high: number): void {
  if (view.look.kind !== "palette") return;
  for (let x = 0; x < 160; ++x) {
    context.fillStyle = `rgb(${color(view.look.palette, x / 159).join(",")})`;
    context.fillRect(10 + x, 6, 1, 14);
  }
  context.fillStyle = ink();
  context.textBaseline = "top";
  context.textAlign = "left";
  context.fillText(number(low), 10, 24);
  context.textAlign = "right";
  context.fillText(`${number(high)} ${unit(view.unit)}`, 170, 24);
}

export function drawLegend(into: HTMLElement, view: View, low: number, high: number): void {
  into.replaceChildren();
  if (view.look.kind === "light") return;
  const cyclic = view.look.palette === "cyclic";
  const [width, height] = cyclic ? [132, 132] : [180, 42];
  const scale = Math.max(devicePixelRatio, 1);
  const canvas = element("canvas", {
    width: width * scale, height: height * scale, role: "img", style: `width:${width}px;height:${height}px`,
    "aria-label": cyclic
      ? "Colour wheel of the angle of polarization: light at 0 degrees, yellow at 45, dark at 90, blue at 135"
      : `Colour scale from ${number(low)} to ${number(high)} ${view.unit}`,
  });
  const context = canvas.getContext("2d")!;
  context.scale(scale, scale);
  context.font = "12px system-ui, sans-serif";
  if (cyclic) wheel(context, width);
  else bar(context, view, low, high);
  into.append(canvas);
}
