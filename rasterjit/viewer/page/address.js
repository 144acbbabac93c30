// The view behind the # of the address: where from, how, and without which objects.

const DIGITS = 9;

const numbersOf = (text) => (text ? text.split(",").map(Number) : []);
const short = (number) => String(Number(number.toPrecision(DIGITS)));

export function written({view, kind, switched, modes, hidden, only}) {
  const parts = new URLSearchParams();
  for (const name of ["eye", "target", "up"]) {
    parts.set(name, view[name].map(short).join(","));
  }
  parts.set("fov_y", short(view.fov_y));
  if (kind !== "color") {
    parts.set("look", kind);
  }
  if (switched.length) {
    parts.set("switched", switched.join(","));
  }
  const on = Object.entries(modes).filter(([, mode]) => mode !== null);
  if (on.length) {
    parts.set("modes", on.map((pair) => pair.join(":")).join(","));
  }
  if (only !== null) {
    parts.set("only", only);
  } else if (hidden.length) {
    parts.set("hidden", hidden.join(","));
  }
  // Commas and colons mean nothing else here.
  return `#${parts.toString().replaceAll("%2C", ",").replaceAll("%3A", ":")}`;
}

// Returns the messages that show what an address says.
export function read(hash) {
  const parts = new URLSearchParams(hash.slice(1));
  if (!parts.has("eye")) {
    return null;
  }
  const [eye, target, up] = ["eye", "target", "up"].map((name) => numbersOf(parts.get(name)));
  const modes = (parts.get("modes") ?? "").split(",").filter(Boolean);
  return {
    view: {eye, target, up, fov_y: Number(parts.get("fov_y"))},
    look: {
      kind: parts.get("look") ?? "color",
      switched: (parts.get("switched") ?? "").split(",").filter(Boolean),
      modes: Object.fromEntries(modes.map((pair) => pair.split(":"))),
    },
    visibility: {
      hidden: numbersOf(parts.get("hidden")),
      only: parts.has("only") ? Number(parts.get("only")) : null,
    },
  };
}
