// Colors that people with any kind of color vision can tell apart: matplotlib's maps, and those of Okabe and Ito.

const RAMPS = {
  viridis:
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725",
  cividis:
    "00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838",
  magma:
    "000004 0a0822 1d1147 36106b 51127c 6a1c81 832681 9c2e7f b73779 d0416f e75263 f56b5c fc8961 fea772 fec488 fde2a3 fcfdbf",
  plasma:
    "0d0887 310597 4c02a1 6600a7 7e03a8 9511a1 aa2395 bc3587 cc4778 da5a6a e66c5c f0804e f89540 fdac33 fdc527 f8df25 f0f921",
};
const CATEGORIES = "0072b2 e69f00 009e73 cc79a7 56b4e9 d55e00 f0e442 999999";
const UNKNOWN = [128, 128, 128];
const TEXELS = 256; // of a palette; the last is for what is not known
const LEFT_OUT = 256; // the texel behind them, of points that the map left out
const LEFT_OUT_COLOR = [226, 40, 60];

const colorsOf = (hexes) => hexes.split(" ").map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));

/** A palette that changes evenly, by its name. */
function ramp(name) {
  const stops = colorsOf(RAMPS[name]);
  const colors = [];
  for (let k = 0; k < TEXELS - 1; k++) {
    const at = (k / (TEXELS - 2)) * (stops.length - 1);
    const before = Math.min(Math.floor(at), stops.length - 2);
    colors.push(stops[before].map((value, c) => Math.round(value + (at - before) * (stops[before + 1][c] - value))));
  }
  return [...colors, UNKNOWN];
}

/** A palette of unlike colors, which repeat. */
function categories() {
  const colors = colorsOf(CATEGORIES);
  return [...Array.from({ length: TEXELS - 1 }, (_, k) => colors[k % colors.length]), UNKNOWN];
}
