"""Parts of the filter that users may replace by their own: what each must do, and how it is found."""
