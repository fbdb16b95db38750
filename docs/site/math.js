// Formulas by KaTeX, in the pages' own copy. One that it cannot read stands as its text, in red.
document.querySelectorAll(".arithmatex").forEach(element => {
  const text = element.textContent.trim();
  const shown = text.startsWith("\\[");
  katex.render(text.slice(2, -2), element, {displayMode: shown, throwOnError: false});
});
