// In the place of the theme's file of this name: 1.5 MB of icons as SVG, for a page that shows six of them. The theme's
// style sheet draws the same icons from a font; book.css mends the two rules that count on the SVG.
