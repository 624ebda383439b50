// Every text on the page against what is behind it, by WCAG 2: [text, ratio, wanted] of each that is too weak.
() => {
  const numbers = (colour) => { const [r, g, b, a = 1] = colour.match(/[\d.]+/g).map(Number); return [r, g, b, a]; };
  const light = (colour) => {
    const [r, g, b] = colour.slice(0, 3).map((part) => part / 255).map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (one, other) => { const [high, low] = [light(one), light(other)].sort((a, b) => b - a); return (high + 0.05) / (low + 0.05); };
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const style = getComputedStyle(at), colour = numbers(style.backgroundColor);
      if (Number(style.opacity) < 1) throw new Error(`${at.id || at.tagName} is see-through`);
      if (colour[3] === 1) return colour;
      if (colour[3] > 0) throw new Error(`${at.id || at.tagName} has a see-through background`);
    }
    return [255, 255, 255];
  };
  const weak = []; let looked_at = 0;
  const look = (element, text) => {
    const style = getComputedStyle(element), size = parseFloat(style.fontSize), bold = Number(style.fontWeight) >= 700;
    const wanted = size >= 24 || (bold && size >= 18.66) ? 3 : 4.5, found = ratio(numbers(style.color), behind(element));
    looked_at++;
    if (found < wanted) weak.push([text.slice(0, 40), Number(found.toFixed(2)), wanted]);
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), element = walker.currentNode.parentElement;
    if (text && element.checkVisibility() && !["SCRIPT", "STYLE"].includes(element.tagName)) look(element, text);
  }
  for (const element of document.querySelectorAll("input, textarea")) if (element.checkVisibility()) look(element, `#${element.id}`);
  const card = numbers(getComputedStyle(document.querySelector("main section")).backgroundColor);
  for (const [name, wanted] of [["--text", 4.5], ["--dim", 4.5], ["--now", 3], ["--before", 3], ["--second", 3], ["--third", 3], ["--fourth", 3]]) {
    const probe = document.createElement("i"); probe.style.color = `var(${name})`; document.body.append(probe);
    const found = ratio(numbers(getComputedStyle(probe).color), card); probe.remove(); looked_at++;
    if (found < wanted) weak.push([`charts: ${name}`, Number(found.toFixed(2)), wanted]);
  }
  return { weak, looked_at };
}
